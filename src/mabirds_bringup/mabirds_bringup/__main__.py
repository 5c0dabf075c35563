"""``python -m mabirds_bringup``: the ``mabirds`` command."""

from mabirds_bringup.cli import main

if __name__ == "__main__":
    main()
