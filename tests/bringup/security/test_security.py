"""Policies and permissions: who may say and hear what, in SROS2's words and in those of DDS Security."""

from collections.abc import Callable
from datetime import UTC, datetime, timedelta
from fnmatch import fnmatchcase
from pathlib import Path
from typing import Any
from xml.etree import ElementTree as ET

import pytest

from mabirds_bringup.security.permissions import (
    Validity,
    governance_xml,
    permissions_xml,
    publications,
    subscriptions,
)
from mabirds_bringup.security.policy import Access, Policy, policy_xml
from mabirds_core.experiment.file import Experiment, load_experiment
from mabirds_msgs_py.security import SecurityError

BEGIN = datetime(2026, 1, 1, tzinfo=UTC)
VALIDITY = Validity(BEGIN, BEGIN + timedelta(days=30))

# learner_1 and learner_3 never talk to each other directly.
LINE = {"kind": "slots", "slots": [[["learner_1", "learner_2"], ["learner_2", "learner_3"]]], "undirected": True}

WATCHERS = ("/monitor", "/inspector", "/dashboard", "/drawing", "/picture")

MakeExperiment = Callable[..., Path]


@pytest.fixture
def line(make_experiment: MakeExperiment) -> Experiment:
    return load_experiment(make_experiment(learners=3, schedule=LINE))


def by_enclave(policy: Policy) -> dict[str, Access]:
    return {process.enclave: process for process in policy.processes()}


def parsed(text: str) -> ET.Element:
    return ET.fromstring(text)  # noqa: S314 - written by what is tested


# Policies


def test_a_learner_hears_its_scheduled_in_neighbours_only(line: Experiment) -> None:
    processes = by_enclave(Policy(line))
    first, middle = processes["/learner_1"], processes["/learner_2"]
    assert first.subscribe == ("/learner_1/demonstration", "/learner_2/parameters")
    assert first.request == ("/learner_2/fetch_parameters",)
    assert middle.subscribe == ("/learner_1/parameters", "/learner_2/demonstration", "/learner_3/parameters")


def test_directed_edges_count_in_their_direction(make_experiment: MakeExperiment) -> None:
    ring = load_experiment(make_experiment(learners=3, schedule={"kind": "directed_ring"}))
    heard = {name: process.subscribe for name, process in by_enclave(Policy(ring)).items()}
    assert "/learner_3/parameters" in heard["/learner_1"]
    assert "/learner_2/parameters" not in heard["/learner_1"]


def test_a_resilient_learner_gives_and_takes_mass_along_the_schedule_only(make_experiment: MakeExperiment) -> None:
    change = {"mixing": {"kind": "resilient"}}
    ring = load_experiment(make_experiment(change, learners=3, schedule={"kind": "directed_ring"}))
    own = by_enclave(Policy(ring, "/depot"))["/depot/learner_1"]
    assert [name for name in own.publish if "mass" in name] == ["/depot/learner_1/mass/learner_2"]
    assert own.subscribe == ("/depot/learner_1/demonstration", "/depot/learner_3/mass/learner_1", "/depot/membership")


@pytest.mark.parametrize(
    "schedule",
    [LINE, {"kind": "static"}, {"kind": "alternating"}, {"kind": "directed_ring"}, {"kind": "gossip", "slots": 9}],
)
@pytest.mark.parametrize("fleet", ["/", "/depot"])
def test_nobody_reads_demonstrations_of_others_or_speaks_for_them(
    make_experiment: MakeExperiment, schedule: dict[str, Any], fleet: str
) -> None:
    experiment = load_experiment(make_experiment(learners=3, schedule=schedule))
    processes, root = by_enclave(Policy(experiment, fleet)), fleet.rstrip("/")
    for name in experiment.learners:
        own, demonstration = f"{root}/{name}", f"{root}/{name}/demonstration"
        readers = {enclave for enclave, process in processes.items() if demonstration in process.subscribe}
        writers = {enclave for enclave, process in processes.items() if demonstration in process.publish}
        assert (readers, writers) == ({own}, {f"{root}/expert_player"})
        for topic in ("parameters", "status", "constraints", "edge_schedule"):
            speakers = {enclave for enclave, process in processes.items() if f"{own}/{topic}" in process.publish}
            assert speakers == {own}
        servers = {enclave for enclave, process in processes.items() if f"{own}/fetch_parameters" in process.reply}
        assert servers == {own}


def test_those_who_watch_publish_nothing_of_the_network(line: Experiment) -> None:
    processes = by_enclave(Policy(line))
    for enclave in ("/monitor", "/inspector", "/dashboard", "/picture"):
        assert processes[enclave].publish == ("/parameter_events", "/rosout")
        assert not any("demonstration" in name for name in processes[enclave].subscribe)


def test_a_central_method_takes_the_learners_place(line: Experiment) -> None:
    processes = by_enclave(Policy(line, method="ftl"))
    assert set(processes) == {"/ftl", "/expert_player", "/player_client", *WATCHERS}
    assert processes["/ftl"].subscribe == tuple(f"/{name}/demonstration" for name in line.learners)
    assert processes["/expert_player"].subscribe == ("/ftl/status",)


def test_no_name_is_a_pattern_but_for_what_is_drawn_of_a_learner(line: Experiment) -> None:
    """Else a name would match more than itself. What matches these, nobody but drawings publishes."""
    processes = Policy(line, "/depot").processes()
    names = {name for one in processes for name in (*one.publish, *one.subscribe, *one.reply, *one.request)}
    patterns = {name for name in names if set(name) & set("*?[]~{}")}
    assert patterns == {f"/depot/{name}/drawn/{kind}" for name in line.learners for kind in ("*", "costs/*")}
    assert all(name.startswith("/") for name in names)
    for name in names - patterns:
        assert not any(fnmatchcase(name, pattern) for pattern in patterns)


def test_drawings_publish_drawings_only_and_hear_no_demonstrations(line: Experiment) -> None:
    processes = by_enclave(Policy(line))
    drawing = processes["/drawing"]
    assert all("/drawn/" in name for name in set(drawing.publish) - {"/parameter_events", "/rosout"})
    assert not any("demonstration" in name for name in drawing.subscribe)
    assert drawing.request == processes["/picture"].request == ()
    assert [name for name, one in processes.items() if any("/drawn/" in topic for topic in one.publish)] == ["/drawing"]


def test_a_page_calls_what_its_buttons_do_and_nothing_else(line: Experiment) -> None:
    calls = by_enclave(Policy(line, "/depot"))["/dashboard"].request
    assert calls == tuple(f"/depot/expert_player/{name}" for name in ("play_next", "set_rate", "toggle_paused"))


def test_a_learner_with_the_name_of_a_watcher_is_refused(make_experiment: MakeExperiment) -> None:
    experiment = load_experiment(make_experiment(change={"learners": ["monitor", "learner_2"]}))
    with pytest.raises(SecurityError, match="enclave /monitor: taken by another process; give the learner another"):
        Policy(experiment).processes()


@pytest.mark.parametrize("fleet", ["depot", "/depot/", "", "/a*", "//"])
def test_a_fleet_that_is_no_namespace_is_refused(line: Experiment, fleet: str) -> None:
    with pytest.raises(SecurityError, match="expected one such as /depot"):
        Policy(line, fleet)


def test_the_policy_file_has_the_shape_that_sros2_reads(line: Experiment) -> None:
    """Version 0.2.0: policy, enclaves, enclave, profiles, profile, and lists with a right each."""
    processes = by_enclave(Policy(line))
    root = parsed(policy_xml(processes.values()))
    assert (root.tag, root.attrib) == ("policy", {"version": "0.2.0"})
    (enclaves,) = root
    assert {enclave.attrib["path"] for enclave in enclaves} == set(processes)
    profile = enclaves.find("enclave[@path='/learner_1']/profiles/profile")
    assert profile is not None
    assert profile.attrib == {"ns": "/learner_1", "node": "learner"}
    found = {(lists.tag, *lists.attrib.items()): tuple(name.text for name in lists) for lists in profile}
    own = processes["/learner_1"]
    assert found == {
        ("topics", ("publish", "ALLOW")): own.publish,
        ("topics", ("subscribe", "ALLOW")): own.subscribe,
        ("services", ("reply", "ALLOW")): own.reply,
        ("services", ("request", "ALLOW")): own.request,
    }
    assert {name.tag for lists in profile if lists.tag == "topics" for name in lists} == {"topic"}
    assert {name.tag for lists in profile if lists.tag == "services" for name in lists} == {"service"}


# Permissions and governance


def test_ros_names_become_dds_names() -> None:
    access = Access("/a", "/a", "n", ("/p",), ("/s/t",), ("/a/n/serve",), ("/b/ask",))
    assert publications(access) == ["ros_discovery_info", "rq/b/askRequest", "rr/a/n/serveReply", "rt/p"]
    assert subscriptions(access) == ["ros_discovery_info", "rq/a/n/serveRequest", "rr/b/askReply", "rt/s/t"]


def test_permissions_have_the_shape_of_dds_security(line: Experiment) -> None:
    """Elements in the order of DDS Security 1.1's schema, everything else denied, one domain, dates."""
    access = by_enclave(Policy(line))["/learner_1"]
    root = parsed(permissions_xml(access, 7, VALIDITY).decode())
    schema = "{http://www.w3.org/2001/XMLSchema-instance}noNamespaceSchemaLocation"
    assert root.attrib[schema].endswith("/DDS-SECURITY/20170901/omg_shared_ca_permissions.xsd")
    (grant,) = root.findall("permissions/grant")
    assert [child.tag for child in grant] == ["subject_name", "validity", "allow_rule", "default"]
    assert (grant.attrib["name"], grant.findtext("subject_name")) == ("/learner_1", "CN=/learner_1")
    assert grant.findtext("default") == "DENY"
    assert [(date.tag, date.text) for date in grant.iterfind("validity/*")] == [
        ("not_before", "2026-01-01T00:00:00"),
        ("not_after", "2026-01-31T00:00:00"),
    ]
    (rule,) = grant.findall("allow_rule")
    assert [child.tag for child in rule] == ["domains", "publish", "subscribe"]
    assert [domain.text for domain in rule.iterfind("domains/*")] == ["7"]
    assert [topic.text for topic in rule.iterfind("publish/topics/topic")] == publications(access)
    assert [topic.text for topic in rule.iterfind("subscribe/topics/topic")] == subscriptions(access)


def test_no_permission_of_a_learner_reaches_one_without_an_edge_to_it(line: Experiment) -> None:
    text = permissions_xml(by_enclave(Policy(line))["/learner_1"], 0, VALIDITY).decode()
    topics = [topic.text or "" for topic in parsed(text).iter("topic")]
    assert "learner_3" not in text
    for forbidden in ("rt/learner_3/parameters", "rt/learner_2/demonstration", "rr/learner_3/fetch_parametersReply"):
        assert not any(fnmatchcase(forbidden, topic) for topic in topics)


def test_governance_is_that_of_the_sros2_tools() -> None:
    root = parsed(governance_xml(7).decode())
    (rule,) = root.findall("domain_access_rules/domain_rule")
    assert [(child.tag, (child.text or "").strip()) for child in rule] == [
        ("domains", ""),
        ("allow_unauthenticated_participants", "false"),
        ("enable_join_access_control", "true"),
        ("discovery_protection_kind", "ENCRYPT"),
        ("liveliness_protection_kind", "ENCRYPT"),
        ("rtps_protection_kind", "SIGN"),
        ("topic_access_rules", ""),
    ]
    assert rule.findtext("domains/id") == "7"
    (topics,) = rule.findall("topic_access_rules/topic_rule")
    assert [(child.tag, child.text) for child in topics] == [
        ("topic_expression", "*"),
        ("enable_discovery_protection", "true"),
        ("enable_liveliness_protection", "true"),
        ("enable_read_access_control", "true"),
        ("enable_write_access_control", "true"),
        ("metadata_protection_kind", "ENCRYPT"),
        ("data_protection_kind", "ENCRYPT"),
    ]
