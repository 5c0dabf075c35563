"""Declaring who takes part in a network in resilient mode, and hearing that everybody follows."""

import time
from collections.abc import Callable, Sequence
from typing import Any

from mabirds_msgs.msg import LearnerStatus, Membership
from rclpy.executors import Executor

from mabirds_core.errors import MabirdsError
from mabirds_core.texts import sanitize
from mabirds_msgs_py import topics
from mabirds_msgs_py.declaration_key import UNSIGNED
from mabirds_msgs_py.mass_conversion import membership_message
from mabirds_msgs_py.network_node import NetworkNode
from mabirds_msgs_py.qos import STATUS_QOS, latched

REFUSALS = ("impossible_schedule", UNSIGNED)
"""What a learner counts that does not follow: its schedule would fall apart, or it asks for a signature."""


class DeclarationError(MabirdsError):
    """A declaration that cannot be made, or that learners do not follow."""


class MembershipPublisher(NetworkNode):
    """Listens to the members-to-be and declares them.

    ``digest``: of the network; "": of the one that is heard. ``key``: with which declarations are signed.
    """

    def __init__(self, members: Sequence[str], digest: str = "", key: bytes = b"", **node_options: Any) -> None:
        super().__init__("declarer", **node_options)
        self._members, self._digest, self._key = list(members), digest, key
        self.statuses: dict[str, LearnerStatus] = {}
        self._publisher = self.create_publisher(Membership, topics.MEMBERSHIP, latched(1))
        for name in self._members:
            self.create_subscription(LearnerStatus, f"{name}/{topics.STATUS}", self._on_status, STATUS_QOS)

    def _on_status(self, status: LearnerStatus) -> None:
        if status.learner in self._members and self._digest in {"", status.experiment_digest}:
            self.statuses[status.learner] = status

    def declare(self, executor: Executor, timeout: float) -> int:
        """Declare the members and wait until all follow; returns the new epoch.

        Raises DeclarationError where not all members are heard, where they are of different networks or in strict
        mode, or where they do not follow within ``timeout`` seconds.
        """
        self._spin(executor, timeout, lambda: len(self.statuses) == len(self._members))
        if missing := sorted(set(self._members) - self.statuses.keys()):
            raise DeclarationError(
                f"{', '.join(missing)}: not heard within {timeout:g} s; start them, or leave them out"
            )
        epoch = max(status.epoch for status in self.statuses.values()) + 1
        self._publish(epoch)
        self._spin(executor, timeout, lambda: self._followed(epoch) or self._refusals())
        if refusals := self._refusals():
            raise DeclarationError(refusals[0])
        if not self._followed(epoch):
            raise DeclarationError(f"not all of {', '.join(self._members)} followed epoch {epoch} within {timeout:g} s")
        return epoch

    def _publish(self, epoch: int) -> None:
        digests = {status.experiment_digest for status in self.statuses.values()}
        if len(digests) > 1:
            raise DeclarationError(f"{', '.join(self._members)}: of different networks, digests {sorted(digests)}")
        if epoch == 1:
            raise DeclarationError("these learners run in strict mode, where all learners always take part")
        self._refused_before = {name: self._refused(name) for name in self._members}
        message = membership_message(digests.pop(), epoch, self._members, self._key)
        message.stamp = self.get_clock().now().to_msg()
        self._publisher.publish(message)

    def _followed(self, epoch: int) -> bool:
        return all(status.epoch == epoch for status in self.statuses.values())

    def _refused(self, name: str) -> int:
        status = self.statuses[name]
        counts = dict(zip(status.drop_reasons, status.drop_counts, strict=False))
        return sum(counts.get(reason, 0) for reason in REFUSALS)

    def _refusals(self) -> list[str]:
        """What learners say that have refused since the declaration."""
        refused = [name for name in self._members if self._refused(name) > self._refused_before[name]]
        return [f"{name}: {sanitize(self.statuses[name].message)}" for name in refused]

    def _spin(self, executor: Executor, timeout: float, condition: Callable[[], object]) -> None:
        deadline = time.monotonic() + timeout
        while not condition() and time.monotonic() < deadline:
            executor.spin_once(timeout_sec=0.1)
