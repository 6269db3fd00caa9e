//! Procedural RGBD photographs: rooms and streets for smoke runs, tests and benches.
