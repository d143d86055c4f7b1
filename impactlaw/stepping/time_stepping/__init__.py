"""Time stepping after Moreau and Jean: impacts, persistent contact and friction in one problem per step."""
