"""`quadctl console`: a web page that shows one vehicle and flies it."""
