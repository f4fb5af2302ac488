"""Actuators: what stands between the torque that is asked of a motor and the torque it gives."""
