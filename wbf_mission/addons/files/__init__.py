"""Files and logs of a simulated vehicle, which clients read by MAVLink FTP and LOG_REQUEST_*."""
