"""HTTP: the routes, who may use them, the live stream, and the server inside the daemon."""
