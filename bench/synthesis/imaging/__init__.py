"""Images: light, surfaces, lens and sensor."""
