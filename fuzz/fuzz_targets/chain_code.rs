#![no_main]

spinney_fuzz::fuzz!(chain_code);
