#![no_main]

spinney_fuzz::fuzz!(autumnal_layers);
