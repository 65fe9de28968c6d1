"""Files and logs of a simulated vehicle over MAVLink FTP and LOG_REQUEST_*."""
