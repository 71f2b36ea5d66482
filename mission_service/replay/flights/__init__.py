"""Analysis of flown flights from logs and journals, and open-loop replay of them by the core."""
