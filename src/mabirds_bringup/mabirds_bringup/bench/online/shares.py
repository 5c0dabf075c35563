"""A share of a processor for each process and no more, as if each had a slower processor of its own.

Control groups of Linux see to it, of either version: a process that has had its share of a period waits for the next.
"""

import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from mabirds_bringup.run.processes import NodeProcess
from mabirds_core.errors import MabirdsError

QUOTA = 1_000
"""Microseconds for which a process runs in each period: the least that Linux takes, so that nobody waits long."""

GROUPS = Path("/sys/fs/cgroup")


@contextmanager
def shared_out(share: float) -> Iterator["Shares"]:
    """Shares for the processes of some runs.

    Parameters
    ----------
    share : float
        Of a processor.

    Yields
    ------
    Shares
        Its groups are gone afterwards.

    Raises
    ------
    MabirdsError
        This user, or this system, cannot limit processes.
    """
    shares = Shares(share)
    try:
        yield shares
    finally:
        shares.close()


class Shares:
    """Control groups, one for each process.

    Parameters
    ----------
    share : float
        Of a processor.
    """

    def __init__(self, share: float) -> None:
        self._share, self._groups = share, list[Path]()

    def limit(self, process: NodeProcess) -> None:
        """Give a process, and all that it starts, the share.

        Parameters
        ----------
        process : NodeProcess
            Runs already.

        Raises
        ------
        MabirdsError
            It cannot be limited.
        """
        period = round(QUOTA / self._share)
        try:
            if (GROUPS / "cgroup.controllers").exists():
                group = self._group(GROUPS, process.popen.pid)
                (group / "cpu.max").write_text(f"{QUOTA} {period}", encoding="ascii")
            else:
                group = self._group(GROUPS / "cpu", process.popen.pid)
                (group / "cpu.cfs_period_us").write_text(str(period), encoding="ascii")
                (group / "cpu.cfs_quota_us").write_text(str(QUOTA), encoding="ascii")
            (group / "cgroup.procs").write_text(str(process.popen.pid), encoding="ascii")
        except OSError as error:
            raise MabirdsError(
                f"--share {self._share:g}: processes cannot be limited ({error}); run it as root where control groups"
                " have the controller cpu, or leave --share out"
            ) from None

    def _group(self, parent: Path, process: int) -> Path:
        group = parent / f"mabirds_{os.getpid()}_{process}"
        group.mkdir()
        self._groups.append(group)
        return group

    def close(self) -> None:
        """Remove the groups, whose processes have ended."""
        for group in self._groups:
            group.rmdir()
        self._groups.clear()
