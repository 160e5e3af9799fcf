#![no_main]

spinney_fuzz::fuzz!(model_read);
