#![no_main]

spinney_fuzz::fuzz!(vrt);
