"""The command line as `python -m impactlaw`."""

from impactlaw.cli import main

if __name__ == "__main__":
    main()
