"""What GMR is compared with: each baseline turns a manifest into predicted world motions."""
