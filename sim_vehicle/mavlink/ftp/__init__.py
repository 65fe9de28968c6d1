"""MAVLink FTP: files of the simulated vehicle, in memory, and the protocol that reads and writes them."""
