#![no_main]

spinney_fuzz::fuzz!(world_file);
