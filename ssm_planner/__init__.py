"""Planning, verification and export for serial spherical mechanisms with self-locking drives."""
