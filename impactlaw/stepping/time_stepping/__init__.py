"""Time stepping after Moreau and Jean: impacts, held contact and friction in one problem a step."""
