//! Samples of a running machine: messages, their order, MQTT and growing files.
//!
//! A [`message`] carries one sample or a batch. An [`inbox`] puts samples in order of their times, drops those that came
//! twice and states what is missing. [`mqtt`] is the connection to a [`broker`], [`follow`] a file that grows.

pub mod broker;
pub mod follow;
pub mod inbox;
pub mod message;
pub mod mqtt;
pub mod stamped;
