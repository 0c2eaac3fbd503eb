"""What happens when something is clicked, brushed or computed: thin functions between the page and the session."""
