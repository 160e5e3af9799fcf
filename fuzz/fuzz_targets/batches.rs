#![no_main]

spinney_fuzz::fuzz!(batches);
