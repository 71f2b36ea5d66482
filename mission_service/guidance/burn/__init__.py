"""The guidance of prescribed burns, and the approval of their plans. Pure; see ARCHITECTURE.md."""
