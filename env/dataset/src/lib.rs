//! env/dataset
