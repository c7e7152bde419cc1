"""What runs in the contestants' environment: no lidario here, and nothing but the contestant and pyserial."""
