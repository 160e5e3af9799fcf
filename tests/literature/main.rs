//! What the papers of `docs/literature.md` describe, held to worked examples and to models that follow the text.

mod chain_codes;
