"""MQTT: the connection to a broker, publications, commands, and messages between vehicles."""
