//! Tests of the cell as a whole.
