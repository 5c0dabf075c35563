"""Entry point of the ``mabirds`` command: loads the application, which takes a second, and runs it."""

from mabirds_msgs_py.early import loading


def main() -> None:
    """Run the command of this process."""
    with loading():
        from mabirds_bringup.application import main as application
    application()
