#![no_main]

spinney_fuzz::fuzz!(df_text);
