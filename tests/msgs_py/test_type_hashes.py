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
    "mabirds_msgs/msg/FeatureNames": "RIHS01_804eafea33b9ebd8bda3652336593700e29a625dc0e6e0fd5281ff0042965e6b",
    "mabirds_msgs/msg/LearnerStatus": "RIHS01_5a9abe674a3603603ee78dbdb0f22524f09f5f70a78fe8ec9b8266c85797746a",
    "mabirds_msgs/msg/Mass": "RIHS01_f645915c29f11125f88a4be6e805dbba86127fe053d178e5bb6837c1adf931e7",
    "mabirds_msgs/msg/Membership": "RIHS01_3a9818d4cd2724db434d7ec16aa4c5ff51c1a4c0a315cca98432816fdb46e2c1",
    "mabirds_msgs/msg/Parameters": "RIHS01_767819e8912bf342586795e2beef4c02b14f867a366e3a3371ba985dd7e6c339",
    "mabirds_msgs/msg/PlayerStatus": "RIHS01_cb2ce8a4c1d29fa969a5c2af2850ee98c7476aa184d3dfa28f4ddae7a65af0b7",
    "mabirds_msgs/srv/Burst": "RIHS01_797524764367026419c893cb11ed09b3229ed44afaed820791b3de37e7c6f4ab",
    "mabirds_msgs/srv/FetchParameters": "RIHS01_ce7df96d420ac1bb477b5be4e16ce5f3d379cb52dae002b2ee06de70bb77e158",
    "mabirds_msgs/srv/GetRate": "RIHS01_f33620e6979e5dc74522116ccaf72f23d3d897dfc79aac48f8c13c7295a691f5",
    "mabirds_msgs/srv/IsPaused": "RIHS01_eaa362003c11a1fd175c6c0b0669f4422caec384610473919602c646f1c66911",
    "mabirds_msgs/srv/Pause": "RIHS01_8e283135438c5787e04e72db8844255219ce90d1be1a9ce482063761ed004d0e",
    "mabirds_msgs/srv/Play": "RIHS01_614bf366cfe0c9bb5d8dc3a67cd281957c15062e2d1ca64a46111fdfc81022dd",
    "mabirds_msgs/srv/PlayNext": "RIHS01_7ad35b2f09d40c0ef11c2ebf5aba54324d51f03d90107dab8ee14721752abc12",
    "mabirds_msgs/srv/Resend": "RIHS01_9c10db922830df03bf4d27181325e236872c588344cd21a786c137a5561664b3",
    "mabirds_msgs/srv/Resume": "RIHS01_ea8d87007c4b00e33572dcae3f028139c4cd47b5c868c70c7d4800b83cc6b068",
    "mabirds_msgs/srv/Seek": "RIHS01_b8b45e9dd2ccccc678f66293ea6e65f11e7120df354082ec739e37ca1ea24f6f",
    "mabirds_msgs/srv/SetRate": "RIHS01_1177912dd7c9b70f03d99419511c6ff5db64f09e07156bd1bd3aaa230e5c30fe",
    "mabirds_msgs/srv/Stop": "RIHS01_f8388b76fe497b53fe54e1818cf142483862cac25d1f8cbc5c1da5247f87b941",
    "mabirds_msgs/srv/TogglePaused": "RIHS01_637c616c7c95fb87e90d83701411d0c1d0d8a9c16e4b5059ee94ab1b5925e0ed",
}


def test_no_message_changes_by_accident() -> None:
    share = Path(get_package_share_directory("mabirds_msgs"))
    found = {}
    for file in [*share.glob("msg/*.json"), *share.glob("srv/*.json")]:
        name = f"mabirds_msgs/{file.parent.name}/{file.stem}"
        hashes = json.loads(file.read_text(encoding="utf-8"))["type_hashes"]
        found[name] = next(entry["hash_string"] for entry in hashes if entry["type_name"] == name)
    assert found == PINNED
