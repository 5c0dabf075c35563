"""The files of DDS Security 1.1 that a middleware enforces: governance for the domain, permissions for each process.

ROS names become DDS names: a topic /a is rt/a; a service /a is the topics rq/aRequest and rr/aReply.
"""

from collections.abc import Iterable
from dataclasses import dataclass
from datetime import datetime
from xml.etree import ElementTree as ET

from mabirds_bringup.security.policy import Access

SCHEMA_INSTANCE = "http://www.w3.org/2001/XMLSchema-instance"
SCHEMAS = "http://www.omg.org/spec/DDS-SECURITY/20170901/omg_shared_ca_"

GRAPH_TOPIC = "ros_discovery_info"
"""On which ROS middlewares tell each other which nodes they hold; without it there is no ROS graph."""

DOMAIN_RULE = {
    "allow_unauthenticated_participants": "false",
    "enable_join_access_control": "true",
    "discovery_protection_kind": "ENCRYPT",
    "liveliness_protection_kind": "ENCRYPT",
    "rtps_protection_kind": "SIGN",
}
"""What holds in the whole domain, as the SROS2 tools have it."""

TOPIC_RULE = {
    "topic_expression": "*",
    "enable_discovery_protection": "true",
    "enable_liveliness_protection": "true",
    "enable_read_access_control": "true",
    "enable_write_access_control": "true",
    "metadata_protection_kind": "ENCRYPT",
    "data_protection_kind": "ENCRYPT",
}
"""What holds for every topic, as the SROS2 tools have it."""


@dataclass(frozen=True)
class Validity:
    """From when to when certificates and permissions hold, in UTC and whole seconds."""

    begin: datetime
    end: datetime


def governance_xml(domain: int) -> bytes:
    """The rules of a ROS domain: who is not authenticated stays out, and everything is encrypted."""
    root = _document("governance.xsd")
    rule = ET.SubElement(ET.SubElement(root, "domain_access_rules"), "domain_rule")
    _domains(rule, domain)
    _fill(rule, DOMAIN_RULE)
    _fill(ET.SubElement(ET.SubElement(rule, "topic_access_rules"), "topic_rule"), TOPIC_RULE)
    return _written(root)


def permissions_xml(access: Access, domain: int, validity: Validity) -> bytes:
    """What one process may publish and subscribe to in a ROS domain; everything else is denied."""
    root = _document("permissions.xsd")
    grant = ET.SubElement(ET.SubElement(root, "permissions"), "grant", name=access.enclave)
    ET.SubElement(grant, "subject_name").text = f"CN={access.enclave}"
    times = {"not_before": _time(validity.begin), "not_after": _time(validity.end)}
    _fill(ET.SubElement(grant, "validity"), times)
    rule = ET.SubElement(grant, "allow_rule")
    _domains(rule, domain)
    _criteria(rule, "publish", publications(access))
    _criteria(rule, "subscribe", subscriptions(access))
    ET.SubElement(grant, "default").text = "DENY"
    return _written(root)


def publications(access: Access) -> list[str]:
    """DDS topics that a process may write to."""
    return sorted(
        [GRAPH_TOPIC, *map(_topic, access.publish), *map(_request, access.request), *map(_reply, access.reply)]
    )


def subscriptions(access: Access) -> list[str]:
    """DDS topics that a process may read."""
    read = [*map(_topic, access.subscribe), *map(_reply, access.request), *map(_request, access.reply)]
    return sorted([GRAPH_TOPIC, *read])


def _topic(name: str) -> str:
    return f"rt{name}"


def _request(service: str) -> str:
    return f"rq{service}Request"


def _reply(service: str) -> str:
    return f"rr{service}Reply"


def _document(schema: str) -> ET.Element:
    return ET.Element("dds", {"xmlns:xsi": SCHEMA_INSTANCE, "xsi:noNamespaceSchemaLocation": f"{SCHEMAS}{schema}"})


def _domains(rule: ET.Element, domain: int) -> None:
    ET.SubElement(ET.SubElement(rule, "domains"), "id").text = str(domain)


def _criteria(rule: ET.Element, right: str, names: Iterable[str]) -> None:
    listed = ET.SubElement(ET.SubElement(rule, right), "topics")
    for name in names:
        ET.SubElement(listed, "topic").text = name


def _fill(parent: ET.Element, values: dict[str, str]) -> None:
    for name, value in values.items():
        ET.SubElement(parent, name).text = value


def _time(moment: datetime) -> str:
    """XML's dateTime; DDS Security takes one without a time zone for UTC."""
    return moment.strftime("%Y-%m-%dT%H:%M:%S")


def _written(root: ET.Element) -> bytes:
    ET.indent(root)
    return ET.tostring(root, encoding="UTF-8", xml_declaration=True) + b"\n"
