"""The Zenoh driver: whoever publishes and answers on Zenoh keys in JSON or MessagePack is a robot."""
