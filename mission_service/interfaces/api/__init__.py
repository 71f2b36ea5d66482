"""HTTP: routes, access control, the live stream, and the server inside the daemon."""
