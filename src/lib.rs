//! deltatwin: a digital twin of the ABB IRB 360-6/1600 delta robot that finds the physical effect its model lacks.

pub mod text;

pub mod model;

pub mod recording;

pub mod kinematics;

pub mod effects;

pub mod dynamics;

pub mod cell;

pub mod scenario;

pub mod twin;

pub mod evidence;

pub mod identification;

pub mod gate;

pub mod excitation;

pub mod constraint_forces;

pub mod planner;

pub mod comparison;

pub mod diagnosis;
