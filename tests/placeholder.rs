//! Whole-system tests live in this folder.
