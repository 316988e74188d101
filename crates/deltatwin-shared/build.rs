//! Without a build script Cargo does not regard the features of build dependencies.

fn main() {
    println!("cargo::rerun-if-changed=build.rs");
}
