"""MQTT: where a broker is, one connection to it, what is published, commands that are taken."""
