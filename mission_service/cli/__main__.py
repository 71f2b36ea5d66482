"""Run the command line as ``python -m mission_service.cli``."""

import sys

from mission_service.cli.main import main

if __name__ == "__main__":
    sys.exit(main())
