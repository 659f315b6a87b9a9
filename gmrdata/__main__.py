"""`python -m gmrdata` is `gmrdata`."""

from gmrdata.cli import main

if __name__ == "__main__":
    main()
