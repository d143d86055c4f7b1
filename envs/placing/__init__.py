"""Put a law into existing environments, in place of the method that steps MuJoCo."""
