#![no_main]

spinney_fuzz::fuzz!(goblin_layers);
