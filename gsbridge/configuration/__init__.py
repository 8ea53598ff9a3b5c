"""The configuration: what `config.yaml` may say, as models that give the defaults, the checks, the schema and the docs."""
