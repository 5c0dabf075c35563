"""Topics that stock tools draw, and pictures of them."""
