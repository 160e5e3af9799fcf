#![no_main]

spinney_fuzz::fuzz!(bintree_text);
