"""What several commands share: flags, the values that flags take, and what is done before and after a render."""
