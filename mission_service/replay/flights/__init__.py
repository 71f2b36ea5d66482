"""Analysis of logged flights (logs and journals), and their open-loop replay by the core."""
