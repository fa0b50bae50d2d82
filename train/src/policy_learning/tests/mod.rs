//! A tiny control problem: both ways of learning solve it in seconds.

mod point_mass;
mod promises;
