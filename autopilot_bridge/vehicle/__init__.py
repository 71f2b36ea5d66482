"""One vehicle behind a link: its client, orders, telemetry, parameters, monitoring."""
