//! End-to-end tests: the real programs on real input, one binary for all of them.

#![allow(clippy::unwrap_used)] // a failed unwrap is a failed test

mod input;
mod layout;
mod maps;
mod report;
mod training;
