//! One run of the twin: its verdict, the cause of a failure, and what follows.
