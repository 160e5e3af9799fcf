#![no_main]

spinney_fuzz::fuzz!(tga);
