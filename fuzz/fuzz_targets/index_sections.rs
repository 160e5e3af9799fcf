#![no_main]

spinney_fuzz::fuzz!(index_sections);
