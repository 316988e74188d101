//! Failure studies: designs of experiments on the twin, a verdict with a cause for every run, and their statistics.

// Chunks of runs, their parts on the disk, and the table made of them.
pub mod campaign;

// Recordings as the same kind of table.
pub mod recording;

// Factors and the points at which they are set.
pub mod design;

// One run: the twin, its verdict, the cause and what follows.
pub mod run;

// Sensitivity indices, rare events, intervals.
pub mod statistics;

// A study from its file to its table.
pub mod conduct;
