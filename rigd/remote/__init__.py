"""Control of a rig from elsewhere: a protocol on zenoh, its server, and a client."""
