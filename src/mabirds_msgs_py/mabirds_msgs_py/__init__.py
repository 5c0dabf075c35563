"""Between arrays and the network: message conversion, topic names, QoS profiles, bags, the process's environment."""
