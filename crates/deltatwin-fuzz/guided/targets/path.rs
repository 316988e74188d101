#![no_main]

libfuzzer_sys::fuzz_target!(|data: &[u8]| deltatwin_fuzz::guided::read("path", data));
