"""Before anything is imported: tests choose middleware, peers and arithmetic, not those who run them."""

import os
import re

STEERING = re.compile(
    "(RMW|FASTDDS|FASTRTPS|CYCLONEDDS)_.*"
    "|ROS_(DOMAIN_ID|LOCALHOST_ONLY|STATIC_PEERS|DISCOVERY_SERVER|SUPER_CLIENT|SECURITY_.*)"
)

for name in filter(STEERING.fullmatch, list(os.environ)):
    del os.environ[name]

# One kernel of linear algebra on all processors that have it, so that the last bits are those of the recorded results.
os.environ["OPENBLAS_CORETYPE"] = "Haswell"
