"""Parser of the dialect: `grammar.lark` compiled by lark to `grammar.json`, run by an LALR engine of our own.

`lexer`, `lalr` and `parse_tables` are the stages of `agentd.language.parse`, `ast_builder` makes the syntax tree,
`fact_runs` reads long runs of ground facts quickly.
"""
