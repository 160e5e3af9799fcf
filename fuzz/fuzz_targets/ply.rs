#![no_main]

spinney_fuzz::fuzz!(ply);
