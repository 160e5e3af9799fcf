#![no_main]

spinney_fuzz::fuzz!(calculation_text);
