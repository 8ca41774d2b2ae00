"""Parser of the dialect: `grammar.lark` compiled by lark to `grammar.json`, run by an LALR engine of our own.

`parser` is the entry (`parse_file`, `parse_text`); `lexer`, `lalr` and `parse_tables` are its stages, `ast_builder`
makes the syntax tree, `fact_runs` reads long runs of ground facts quickly, `nesting_limit` bounds depth.
"""
