"""Motion of fixed wings: compiled airframe and guidance, and the control of PX4 and ArduPlane."""
