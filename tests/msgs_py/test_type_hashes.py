"""The messages' type hashes, by which nodes of different builds know whether they understand each other.

A change of a message changes its hash: then the old nodes and bags no longer fit, CHANGELOG says so, and this table is
written anew.
"""

import json
from pathlib import Path

from ament_index_python.packages import get_package_share_directory

PINNED = {
    "mabirds_msgs/msg/Constraints": "RIHS01_960cb51cb7f590265a115882f94b448aa891c67068b4b50699f2a1037be3c868",
    "mabirds_msgs/msg/Demonstration": "RIHS01_644297b56d5102c007101d64487a4a67cc91cfa223af66f1e1ac57b6482fb379",
    "mabirds_msgs/msg/EdgeSchedule": "RIHS01_e495cad55ac19022d1cd96a814b8f06b9cbd89953ca62a5d1f7b58b7080e5006",
    "mabirds_msgs/msg/LearnerStatus": "RIHS01_5a9abe674a3603603ee78dbdb0f22524f09f5f70a78fe8ec9b8266c85797746a",
    "mabirds_msgs/msg/Mass": "RIHS01_f645915c29f11125f88a4be6e805dbba86127fe053d178e5bb6837c1adf931e7",
    "mabirds_msgs/msg/Membership": "RIHS01_3a9818d4cd2724db434d7ec16aa4c5ff51c1a4c0a315cca98432816fdb46e2c1",
    "mabirds_msgs/msg/Parameters": "RIHS01_767819e8912bf342586795e2beef4c02b14f867a366e3a3371ba985dd7e6c339",
    "mabirds_msgs/srv/FetchParameters": "RIHS01_ce7df96d420ac1bb477b5be4e16ce5f3d379cb52dae002b2ee06de70bb77e158",
    "mabirds_msgs/srv/PlayNext": "RIHS01_afc3b99ab353251e5a2e5974382ed332a2215370b432c203f3a5a6e0a755247a",
    "mabirds_msgs/srv/Resend": "RIHS01_9c10db922830df03bf4d27181325e236872c588344cd21a786c137a5561664b3",
}


def test_no_message_changes_by_accident() -> None:
    share = Path(get_package_share_directory("mabirds_msgs"))
    found = {}
    for file in [*share.glob("msg/*.json"), *share.glob("srv/*.json")]:
        name = f"mabirds_msgs/{file.parent.name}/{file.stem}"
        hashes = json.loads(file.read_text(encoding="utf-8"))["type_hashes"]
        found[name] = next(entry["hash_string"] for entry in hashes if entry["type_name"] == name)
    assert found == PINNED
