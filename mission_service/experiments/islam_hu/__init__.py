"""Islam & Hu, section VI: one vehicle that follows the front of six fires."""
