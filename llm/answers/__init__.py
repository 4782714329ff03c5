"""What a model answers to each module: one pydantic schema a file, under the paper's names.

Nothing here is imported with `llm`: pydantic is loaded when a model is first asked.
"""
