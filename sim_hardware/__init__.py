"""The far side of the cable: a simulated bench that speaks the driver's own protocol."""
