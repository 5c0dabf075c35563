"""The loop of a node: messages at once, and everything else that rclpy's executor would have done."""

import time
from collections.abc import Callable, Iterator
from typing import Any

import pytest
import rclpy
from diagnostic_msgs.msg import KeyValue
from rclpy.context import Context
from rclpy.executors import ExternalShutdownException, SingleThreadedExecutor
from rclpy.node import Node
from std_srvs.srv import Trigger

from mabirds_msgs_py.message_loop import MOST_IN_A_ROW, MessageLoop
from mabirds_msgs_py.network_node import NetworkNode
from mabirds_msgs_py.presence import LivelinessMonitor
from mabirds_msgs_py.qos import announced, latched


@pytest.fixture
def node(context: Context) -> Iterator[NetworkNode]:
    made = NetworkNode("one", context=context)
    yield made
    made.destroy_node()


@pytest.fixture
def loop(node: NetworkNode, context: Context) -> Iterator[MessageLoop]:
    made = MessageLoop(node, SingleThreadedExecutor(context=context))
    yield made
    made.close()


def spin_until(loop: MessageLoop, condition: Callable[[], Any], timeout: float = 20.0) -> None:
    deadline = time.monotonic() + timeout
    while not condition():
        assert time.monotonic() < deadline, "not in time"
        loop.spin_once(0.1)


def test_messages_come_in_order_also_to_what_was_made_while_it_ran(node: Node, loop: MessageLoop) -> None:
    heard = list[str]()
    publisher = node.create_publisher(KeyValue, "words", latched(100))
    loop.spin_once(0.0)
    node.create_subscription(KeyValue, "words", lambda message: heard.append(message.key), latched(100))
    for number in range(50):
        publisher.publish(KeyValue(key=str(number)))
    spin_until(loop, lambda: len(heard) == 50)
    assert heard == [str(number) for number in range(50)]


def test_raw_messages_are_bytes(node: Node, loop: MessageLoop) -> None:
    heard = list[bytes]()
    node.create_subscription(KeyValue, "words", heard.append, latched(1), raw=True)
    node.create_publisher(KeyValue, "words", latched(1)).publish(KeyValue(key="here"))
    spin_until(loop, lambda: heard)
    assert b"here" in heard[0]


def test_timers_services_clients_guards_and_events_are_called(node: Node, loop: MessageLoop) -> None:
    ticks, triggered = list[float](), list[str]()

    def answer(_: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        response.message = "answered"
        return response

    node.create_timer(0.02, lambda: ticks.append(time.monotonic()))
    guard = node.create_guard_condition(lambda: triggered.append("guard"))
    node.create_service(Trigger, "ask", answer)
    client = node.create_client(Trigger, "ask")
    spin_until(loop, lambda: len(ticks) > 3 and client.service_is_ready())
    guard.trigger()
    future = client.call_async(Trigger.Request())
    spin_until(loop, lambda: triggered and future.done())
    assert future.result().message == "answered"


def test_events_of_the_middleware_are_told(node: Node, loop: MessageLoop, ros_domain: int) -> None:
    """A publisher in a process of its own, as far as the middleware knows, comes and goes."""
    presence, heard, other = LivelinessMonitor(), list[KeyValue](), Context()
    node.create_subscription(KeyValue, "alive", heard.append, announced(1), event_callbacks=presence.watch("other"))
    rclpy.init(args=[], context=other, domain_id=ros_domain)
    there = Node("other", context=other)
    there.create_publisher(KeyValue, "alive", announced(1)).publish(KeyValue())
    spin_until(loop, lambda: heard and not presence.is_lost("other"))
    there.destroy_node()
    rclpy.try_shutdown(context=other)
    spin_until(loop, lambda: presence.is_lost("other"))


def test_a_guard_that_is_triggered_in_a_callback_is_called_once(node: Node, loop: MessageLoop) -> None:
    called = list[str]()
    guard = node.create_guard_condition(lambda: called.append("guard"))
    node.create_subscription(KeyValue, "words", lambda _: guard.trigger(), latched(1))
    node.create_publisher(KeyValue, "words", latched(1)).publish(KeyValue())
    spin_until(loop, lambda: called)
    for _ in range(10):
        loop.spin_once(0.01)
    assert called == ["guard"]


def test_a_flood_of_messages_lets_timers_have_their_turn(node: Node, loop: MessageLoop) -> None:
    """Each message causes the next."""
    ticks, heard = list[int](), list[int]()
    publisher = node.create_publisher(KeyValue, "words", latched(1))

    def pass_on(message: KeyValue) -> None:
        heard.append(1)
        publisher.publish(message)

    node.create_subscription(KeyValue, "words", pass_on, latched(1))
    node.create_timer(0.001, lambda: ticks.append(len(heard)))
    publisher.publish(KeyValue())
    spin_until(loop, lambda: len(ticks) > 5 and len(heard) > 10 * MOST_IN_A_ROW)


def test_a_flood_of_messages_lets_services_and_new_subscriptions_have_their_turn(node: Node, loop: MessageLoop) -> None:
    heard = list[str]()
    publisher = node.create_publisher(KeyValue, "words", latched(1))

    def answer(_: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        node.create_subscription(KeyValue, "others", lambda message: heard.append(message.key), latched(1))
        return response

    node.create_publisher(KeyValue, "others", latched(1)).publish(KeyValue(key="here"))
    node.create_subscription(KeyValue, "words", publisher.publish, latched(1))
    node.create_service(Trigger, "ask", answer)
    client = node.create_client(Trigger, "ask")
    publisher.publish(KeyValue())
    spin_until(loop, client.service_is_ready)
    future = client.call_async(Trigger.Request())
    spin_until(loop, lambda: heard and future.done())


def test_what_a_message_has_made_is_heard_where_no_other_message_comes(node: Node, loop: MessageLoop) -> None:
    heard = list[str]()
    node.create_publisher(KeyValue, "others", latched(1)).publish(KeyValue(key="here"))
    node.create_subscription(
        KeyValue,
        "words",
        lambda _: node.create_subscription(KeyValue, "others", lambda message: heard.append(message.key), latched(1)),
        latched(1),
    )
    node.create_publisher(KeyValue, "words", latched(1)).publish(KeyValue())
    spin_until(loop, lambda: heard)


def test_a_glance_takes_what_has_gathered_and_no_more_than_it_may(node: Node, loop: MessageLoop) -> None:
    heard, ticks = list[str](), list[int]()
    publisher = node.create_publisher(KeyValue, "words", latched(100))
    node.create_subscription(KeyValue, "words", lambda message: heard.append(message.key), latched(100))
    spin_until(loop, publisher.get_subscription_count)
    for number in range(50):
        publisher.publish(KeyValue(key=str(number)))
    loop.glance(0.2, 1)
    assert 0 < len(heard) < 50, "the others wait"
    node.create_timer(0.01, lambda: ticks.append(len(heard)))
    loop.glance(0.2, 50)
    assert heard == [str(number) for number in range(50)]
    assert ticks, "timers have their turn"


def test_a_glance_answers_services_and_hears_who_is_found_later(node: Node, loop: MessageLoop) -> None:
    heard = list[str]()

    def answer(_: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        node.create_subscription(KeyValue, "words", lambda message: heard.append(message.key), latched(1))
        return response

    node.create_publisher(KeyValue, "words", latched(1)).publish(KeyValue(key="here"))
    node.create_service(Trigger, "ask", answer)
    client = node.create_client(Trigger, "ask")
    assert client.wait_for_service(timeout_sec=20.0)
    future, deadline = client.call_async(Trigger.Request()), time.monotonic() + 20.0
    while not (heard and future.done()):
        assert time.monotonic() < deadline, "not in time"
        loop.glance(0.01, 10)


def test_it_waits_no_longer_than_it_may_and_not_busily(loop: MessageLoop) -> None:
    loop.spin_once(0.0)
    begun, before, turns = time.monotonic(), time.process_time(), 0
    while time.monotonic() - begun < 0.5:
        loop.spin_once(0.1)
        turns += 1
    assert time.process_time() - before < 0.25
    assert turns < 40


def test_the_end_of_the_context_ends_it(loop: MessageLoop, context: Context) -> None:
    loop.spin_once(0.0)
    rclpy.try_shutdown(context=context)
    with pytest.raises(ExternalShutdownException):
        loop.spin_once(10.0)


def test_an_error_of_a_callback_is_not_swallowed(node: Node, loop: MessageLoop) -> None:
    def fail(_: KeyValue) -> None:
        raise ValueError("on purpose")

    node.create_subscription(KeyValue, "words", fail, latched(1))
    node.create_publisher(KeyValue, "words", latched(1)).publish(KeyValue())
    with pytest.raises(ValueError, match="on purpose"):
        spin_until(loop, lambda: False, timeout=5.0)
