#!/bin/sh
# Generates a password once for each volume; the service reads the password from the volume.
set -eu
umask 077
if [ ! -s /run/mqtt/password ]; then
  head -c 24 /dev/urandom | base64 | tr -d '\n' > /run/mqtt/password.new
  mv /run/mqtt/password.new /run/mqtt/password
fi
rm -f /run/mqtt/users
mosquitto_passwd -c -b /run/mqtt/users mission "$(cat /run/mqtt/password)"
exec mosquitto -c /mosquitto/config/mosquitto.conf
