//! End-to-end tests: the real programs on real input, one binary for all of them.

mod input;
mod layout;
mod maps;
mod training;
