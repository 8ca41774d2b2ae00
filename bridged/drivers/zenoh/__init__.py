"""The Zenoh driver: robots that publish and answer on Zenoh keys in JSON or MessagePack."""
