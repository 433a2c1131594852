"""The steps of `toolkit import`: gather the photographs, find what each shows, store it."""
