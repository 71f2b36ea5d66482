#!/bin/sh
# Healthy if the broker accepts its password.
set -eu
exec mosquitto_sub -u mission -P "$(cat /run/mqtt/password)" -W 4 -C 1 -t '$SYS/broker/version' > /dev/null
