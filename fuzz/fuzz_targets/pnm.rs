#![no_main]

spinney_fuzz::fuzz!(pnm);
