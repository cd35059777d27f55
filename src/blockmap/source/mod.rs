//! Files of cities.
