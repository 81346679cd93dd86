"""The vehicle on a web page: `board` to `frame` say what is shown, `link` and `acts` are the way to the bus."""
