"""Words and tables about SIDs, models, scenes, results and judgements."""
