"""What a running network says of itself, checked before it is believed."""
