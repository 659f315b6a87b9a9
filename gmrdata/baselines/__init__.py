"""What GMR is compared with."""
