"""Report a place of fire and a raster to mission-service over HTTP."""

import json
import os
import urllib.error
import urllib.request

URL = os.environ.get("MISSION_SERVICE", "http://127.0.0.1:8765")
HEADERS = {"Authorization": "Bearer " + os.environ["TOKEN"]}
SENSOR = {"source": "tower", "position_sd_m": 15, "false_alarms_pct": 0, "missed_pct": 5}


def post(kind, report):
    body = json.dumps(SENSOR | report).encode()
    request = urllib.request.Request(f"{URL}/api/v1/fire/{kind}", body, HEADERS)
    try:
        with urllib.request.urlopen(request, timeout=30) as reply:
            print(json.load(reply))
    except urllib.error.HTTPError as error:
        print(error.code, json.load(error)["error"])


place = {"state": "burning", "shape": "points", "points": [[36.3700, -84.1500]]}
post("observations", place | {"age_s": 2.5})  # seen 2.5 s ago

edges = {"south_deg": 36.3676, "west_deg": -84.1530, "north_deg": 36.3724, "east_deg": -84.1470}
rows = ["uuuuuu", "uubbuu", "uubbbu", "uubbbu", "uuuuu.", "uuuu.."]  # from north to south
post("observations/raster", edges | {"rows": rows, "age_s": 1.0})
