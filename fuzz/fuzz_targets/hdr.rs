#![no_main]

spinney_fuzz::fuzz!(hdr);
