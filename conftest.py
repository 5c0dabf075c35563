"""Before anything of ROS is imported: tests choose the middleware, and whom they talk to, not those who run them."""

import os
import re

STEERING = re.compile(
    "(RMW|FASTDDS|FASTRTPS|CYCLONEDDS)_.*"
    "|ROS_(DOMAIN_ID|LOCALHOST_ONLY|STATIC_PEERS|DISCOVERY_SERVER|SUPER_CLIENT|SECURITY_.*)"
)

for name in filter(STEERING.fullmatch, list(os.environ)):
    del os.environ[name]
