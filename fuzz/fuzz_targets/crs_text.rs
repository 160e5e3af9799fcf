#![no_main]

spinney_fuzz::fuzz!(crs_text);
