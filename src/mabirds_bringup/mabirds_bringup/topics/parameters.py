"""Parameters and services of any node."""

from typing import Any

import yaml
from rcl_interfaces.msg import Parameter as ParameterMessage
from rcl_interfaces.srv import GetParameters, ListParameters, SetParameters
from rclpy.node import Node
from rclpy.parameter import Parameter, parameter_value_to_python

from mabirds_bringup.topics.listening import Listening, NothingHeardError, allowed
from mabirds_bringup.topics.plain import InspectionError, fill, message_type, plain


class Services:
    """Calls services by name.

    Parameters
    ----------
    node : Node
        That calls.
    listening : Listening
        Spins it.
    """

    def __init__(self, node: Node, listening: Listening) -> None:
        self._node, self._listening = node, listening

    def call(self, service: str, kind: Any, request: Any) -> Any:
        """Call a service.

        Raises
        ------
        NothingHeardError
            Nobody answers.
        """
        with allowed(f"service {service}"):
            client = self._node.create_client(kind, service)
        if not self._listening.spin_until(client.service_is_ready):
            raise NothingHeardError(f"service {service}: nobody serves it; look at `mabirds inspect list --services`")
        future = client.call_async(request)
        if not self._listening.spin_until(future.done):
            raise NothingHeardError(f"service {service}: no answer; its node may be busy, give a longer --timeout")
        return future.result()

    def call_by_name(self, service: str, text: str) -> Any:
        """Call a service with fields in YAML; its answer as plain values."""
        known: dict[str, list[str]] = {}

        def found() -> bool:
            known.update(self._node.get_service_names_and_types())
            return service in known

        if not self._listening.spin_until(found):
            raise NothingHeardError(f"service {service}: nobody serves it; look at `mabirds inspect list --services`")
        kind = message_type(known[service][0])
        try:
            content = yaml.safe_load(text) or {}
        except yaml.YAMLError as error:
            raise InspectionError(f"request {text!r}: no YAML ({' '.join(str(error).split())})") from None
        return plain(self.call(service, kind, fill(kind.Request(), content)))

    def get(self, node: str, names: list[str]) -> dict[str, Any]:
        """Values of parameters.

        Raises
        ------
        InspectionError
            The node does not have one.
        """
        answer = self.call(f"{node}/get_parameters", GetParameters, GetParameters.Request(names=names))
        if len(answer.values) != len(names) or any(value.type == 0 for value in answer.values):
            raise InspectionError(
                f"{node}: has no parameter {', '.join(names)}; see `mabirds inspect param dump {node}`"
            )
        return {name: plain_value(value) for name, value in zip(names, answer.values, strict=True)}

    def dump(self, node: str) -> dict[str, Any]:
        """Values of all parameters."""
        names = self.call(f"{node}/list_parameters", ListParameters, ListParameters.Request()).result.names
        answer = self.call(f"{node}/get_parameters", GetParameters, GetParameters.Request(names=names))
        return {name: plain_value(value) for name, value in zip(names, answer.values, strict=False) if value.type}

    def set(self, node: str, name: str, text: str) -> Any:
        """Set a parameter to a value in YAML, and return it.

        Raises
        ------
        InspectionError
            The node refuses.
        """
        value = yaml.safe_load(text)
        parameter: ParameterMessage = Parameter(name, value=value).to_parameter_msg()
        request = SetParameters.Request(parameters=[parameter])
        (result,) = self.call(f"{node}/set_parameters", SetParameters, request).results
        if not result.successful:
            raise InspectionError(f"{node} refuses {name}: {value!r}: {result.reason or 'it gives no reason'}")
        return value


def plain_value(value: Any) -> Any:
    """The value of a parameter as JSON knows it."""
    content = parameter_value_to_python(value)
    return content if content is None or isinstance(content, str) else plain(content)
