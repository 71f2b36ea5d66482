#!/bin/sh
# Report a place of fire to mission-service over HTTP; with an argument, also this GeoTIFF.
set -eu
fire="${MISSION_SERVICE:-http://127.0.0.1:8765}/api/v1/fire"

curl -sS -H "Authorization: Bearer $TOKEN" "$fire/observations" -d '{
  "state": "burning", "shape": "points", "points": [[36.3705, -84.1490]],
  "age_s": 2.5, "position_sd_m": 15, "source": "tower"}'
echo

if [ $# -gt 0 ]; then
    curl -sS -H "Authorization: Bearer $TOKEN" --data-binary "@$1" \
        "$fire/observations/geotiff?age_s=1&position_sd_m=15&source=tower"
    echo
fi
