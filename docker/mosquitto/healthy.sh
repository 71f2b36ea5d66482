#!/bin/sh
# The container is healthy if the broker accepts the password.
set -eu
exec mosquitto_sub -u mission -P "$(cat /run/mqtt/password)" -W 4 -C 1 -t '$SYS/broker/version' > /dev/null
