#![no_main]

spinney_fuzz::fuzz!(feature_table);
