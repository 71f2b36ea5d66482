"""MQTT: the connection to a broker, publications, commands, messages between vehicles."""
