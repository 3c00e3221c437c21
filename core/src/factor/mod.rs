//! factor.
