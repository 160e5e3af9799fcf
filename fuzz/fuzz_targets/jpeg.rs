#![no_main]

spinney_fuzz::fuzz!(jpeg);
