#!/bin/sh
# Report a place of fire to mission-service over MQTT.
set -eu
site="${SITE:-mission-service/v1/detector}"
now_us="$(date +%s)000000"

mosquitto_pub -h "${BROKER:-127.0.0.1}" -p "${PORT:-1883}" -q 1 -t "$site/cmd/observe" -m '{
  "id": "'"$now_us-$$"'", "by": "tower", "sent_at_unix_us": '"$now_us"',
  "state": "burning", "shape": "points", "points": [[36.3710, -84.1480]],
  "age_s": 2.5, "position_sd_m": 15, "source": "tower"}'
