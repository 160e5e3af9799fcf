#![no_main]

spinney_fuzz::fuzz!(step_text);
